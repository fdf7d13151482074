"""Reports: `report.json`, the HTML pages and their figures."""
