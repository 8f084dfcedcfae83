"""What the scripts of docs/stability.md share: captures made worse by degrees, and sections of a generated page."""
