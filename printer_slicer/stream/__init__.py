"""Host side of the serial protocol: send G-code line by line, and lose or repeat no line."""
