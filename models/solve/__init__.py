"""From a scene to a response: the registry of models, the choice among them, and one folder a model."""
