"""Vehicle models: how the EGO moves on an acceleration and a curvature, one module a model."""
