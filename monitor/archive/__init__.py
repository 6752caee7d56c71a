"""Archives: many recordings of many machines, replayed into one place."""
