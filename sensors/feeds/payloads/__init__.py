"""What instruments send → samples: one module a payload format."""
