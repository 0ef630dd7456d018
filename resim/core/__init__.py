"""What every layer shares: errors, plane geometry, tracks."""
