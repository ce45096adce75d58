"""The `retrieve` command line: words and files, no algorithm."""
