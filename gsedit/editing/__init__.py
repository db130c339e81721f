"""An edit of a scene from a sentence: steps, parts, painters, previews, result and folder."""
