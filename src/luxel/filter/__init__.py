"""Filters of pictures, and how far two pictures are apart."""
