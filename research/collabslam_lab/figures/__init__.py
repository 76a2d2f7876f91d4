"""The figures and pages of all experiments: one look, one writer of their files."""
