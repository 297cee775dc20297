"""The gallery: models that come with hierc, each of which teaches one thing."""
