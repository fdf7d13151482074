"""Languages: the product's texts in the language of the user, from a catalogue of templates for each."""
