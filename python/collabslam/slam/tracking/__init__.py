"""What Cs itself measures in a frame."""
