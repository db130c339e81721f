"""An edit in progress: the request, the views as they are edited, and what is measured."""
