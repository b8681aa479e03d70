"""The version of this package, so that it need not be looked up in the installed metadata."""

from typing import Final

__all__ = ["VERSION"]

VERSION: Final = "0.3.0"
