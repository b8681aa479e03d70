"""The printer's end of the cable: firmware, heaters and motion, simulated without I/O or clock."""
