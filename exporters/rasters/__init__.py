"""Cloud Optimised GeoTIFFs and pictures of surfaces."""
