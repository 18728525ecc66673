"""Geotagged photographs, as mapping flights leave them."""
