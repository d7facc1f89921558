"""Placements in three dimensions in a web page: the library, and the script that shows them."""
