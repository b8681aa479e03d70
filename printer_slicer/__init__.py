"""Slice a part with adaptive layer heights, export G-code, print it over USB serial, or dry-run it."""
