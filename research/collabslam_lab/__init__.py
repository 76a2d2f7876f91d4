"""What proves the product: the paper's experiments, rendered worlds, benchmarks, reliability."""
