"""What the benchmarks share: trials, results, reports, pages, figures, statistics."""
