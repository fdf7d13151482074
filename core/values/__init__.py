"""The values that every part of furrowmap shares: frozen, checked at birth, with units in their names."""
