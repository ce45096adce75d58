"""Reports as tables, plots and files of many forms."""
