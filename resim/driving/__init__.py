"""What the shipped functions drive by, compiled: the lead, an acceleration, a curvature, a plan, for B runs."""
