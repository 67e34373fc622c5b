"""Treelets: small trees over objects in spatial order, below a tree that is always in memory."""
