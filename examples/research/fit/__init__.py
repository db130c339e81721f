"""Error of fits to photos against seconds: the recipe of `gsedit fit` beside gsplat's default."""
