"""The version of this package, for those who must say it without looking for where it is installed."""

from typing import Final

__all__ = ["VERSION"]

VERSION: Final = "0.2.0"
