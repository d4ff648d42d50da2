"""Statistics of residuals, methods side by side, planes found in data."""
