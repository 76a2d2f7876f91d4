"""What can be said of a recording, or of a run, before anybody looks at its pictures."""
