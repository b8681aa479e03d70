"""Print a job on the simulated printer under an invented clock, and judge the result."""
