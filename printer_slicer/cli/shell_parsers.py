"""What can be typed about the shell itself: `completion` and `man`."""

from __future__ import annotations

import argparse

from printer_slicer.cli.parsing import command, later

__all__ = ["add_completion", "add_man"]

_Commands = argparse._SubParsersAction  # noqa: SLF001 - the type of what add_subparsers gives has no other name


def add_completion(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`completion`."""
    parser = command(
        commands,
        "completion",
        "teach a shell to complete commands, flags, profiles and settings",
        "  printer-slicer completion bash > ~/.local/share/bash-completion/completions/printer-slicer\n"
        "  printer-slicer completion zsh > ~/.zfunc/_printer-slicer     with `fpath+=~/.zfunc` before compinit\n"
        "  printer-slicer completion fish > ~/.config/fish/completions/printer-slicer.fish\n"
        '  eval "$(printer-slicer completion bash)"                     only in this shell; zsh likewise',
    )
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
    parser.set_defaults(run=later("manual", "completion_command"))


def add_man(commands: _Commands[argparse.ArgumentParser]) -> None:
    """`man`."""
    parser = command(
        commands,
        "man",
        "write the manual page",
        "  printer-slicer man | man -l -\n"
        "  printer-slicer man > ~/.local/share/man/man1/printer-slicer.1     then: man printer-slicer",
    )
    parser.set_defaults(run=later("manual", "man_command"))
