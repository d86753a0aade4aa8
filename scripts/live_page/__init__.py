"""The live page's parts, and what of the package is written out as JavaScript for it."""
