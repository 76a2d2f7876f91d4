"""What the worn cameras see, and where they are."""
