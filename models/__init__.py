"""What a bearing with a given damage would sound like: geometry, contact, dynamics, maps (first floor)."""
