"""Models that the paper's is compared with: baselines, two chambers of oil, nets; and the comparison."""
