"""What all floors share: exceptions, checks of fields, typed numerical methods."""
