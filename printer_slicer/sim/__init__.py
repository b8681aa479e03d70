"""A simulated printer: firmware, heaters and motion, without I/O and without a clock of its own."""
