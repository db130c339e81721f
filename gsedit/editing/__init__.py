"""An edit of a scene from a sentence: request, views, regions, session, strategies, result."""
