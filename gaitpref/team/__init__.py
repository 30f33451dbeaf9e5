"""Teams of two: what raters want of them, what each robot is paid and what it earns."""
