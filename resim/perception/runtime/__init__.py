"""The perception model at work: what the function sees of the scene, cycle by cycle."""
