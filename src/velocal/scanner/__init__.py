"""What a scanner is: its models, the parameters of its lasers, its beam equations."""
