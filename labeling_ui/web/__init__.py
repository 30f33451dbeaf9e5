"""The way to the page: login, checks, and the proxy before viser."""
