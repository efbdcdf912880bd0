"""One module per version of the catalogue, oldest first."""
