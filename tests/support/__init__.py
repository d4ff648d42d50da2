"""What several tests share: captures made by hand, the simulated chain, a tiny study."""
