"""Recording formats, one reader each."""
