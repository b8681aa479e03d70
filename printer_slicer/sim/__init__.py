"""A simulated printer: firmware, heaters and motion, without I/O or clock."""
