"""Slice many models with many settings, in several processes or on several machines.

tasks (`tasks`) -> `slice_task` in workers (`slicing`, `pool`, `cluster`) -> results in order (`running`) -> files
and manifest (`manifest`) -> table and page (`reports`). One task is one model with one set of settings; it becomes one
file of G-code, or one per plate.
"""
