"""What the shipped functions drive by, compiled: a lead to mind, an acceleration, a curvature, a plan, for B runs."""
