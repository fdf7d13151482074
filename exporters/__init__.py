"""Writers of files: values in, files out."""
