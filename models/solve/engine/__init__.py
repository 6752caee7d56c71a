"""What all models that are simulated over time share."""
