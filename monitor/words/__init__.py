"""Every word and number for people: statuses, quantities, events."""
