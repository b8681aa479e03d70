"""A simulated printer: firmware, heaters and motion, without I/O. It has no clock; callers pass the time."""
