"""Views: cameras, posed pictures, and what cameras see of surfaces."""
