"""The products of a season from the results of its runs."""
