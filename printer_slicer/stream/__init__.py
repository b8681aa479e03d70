"""The host's end of the cable: lines in, bytes out, never a line lost or invented."""
