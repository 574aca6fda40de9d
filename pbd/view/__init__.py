"""Views: the replay's page, the live view, tables."""
