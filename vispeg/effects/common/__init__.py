"""What effects of one or more families share."""
