"""Many recordings: a plan, where the work is done, what came out in one table."""
