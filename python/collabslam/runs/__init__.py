"""Results of a run: the recording through the filter, its checkpoint, and what is written and said."""
