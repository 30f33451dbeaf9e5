"""What is off by default; what each part is good for is told in docs/extensions.md."""
