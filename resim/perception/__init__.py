"""What the vehicle sees, as a model: learned from drives that were measured twice, and put back into simulation."""
