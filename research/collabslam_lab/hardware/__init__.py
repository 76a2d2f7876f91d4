"""What goes wrong with the hardware that people have, and what it costs."""
