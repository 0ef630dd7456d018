"""Tables of any shape: a mapping file says what their columns mean, and they become a recording."""
