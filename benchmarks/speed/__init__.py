"""Speed, as ratios against peers in the same run: one pinned core, BLAS on one thread, interleaved
rounds."""
