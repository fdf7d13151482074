"""How accurate a receiver's positions are, against others of the same antenna or vehicle."""
