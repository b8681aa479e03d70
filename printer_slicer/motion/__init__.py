"""One truth about time: `rules` move by move in plain Python, `whole` over arrays. Import the module you need."""
