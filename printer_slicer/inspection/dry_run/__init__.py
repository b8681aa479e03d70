"""Print a job on the simulated printer in simulated time, and judge the result."""
