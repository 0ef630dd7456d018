"""What a measurement leaves open: who was not seen, whose record contradicts itself, what that can have hidden."""
