"""`completion`: print the completion script for a shell."""

from __future__ import annotations

import argparse
import sys
from typing import Final

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer completion bash > ~/.local/share/bash-completion/completions/printer-slicer
  printer-slicer completion zsh > ~/.zfunc/_printer-slicer     with `fpath+=~/.zfunc` before compinit
  printer-slicer completion fish > ~/.config/fish/completions/printer-slicer.fish
  eval "$(printer-slicer completion bash)"                     only in this shell; zsh likewise"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")


def run(arguments: argparse.Namespace) -> int:
    """Print the completion script."""
    from printer_slicer.cli.shell_completion import make_completion_script

    sys.stdout.write(make_completion_script(arguments.shell))
    return 0
