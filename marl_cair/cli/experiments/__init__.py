"""Commands that run plans of many training runs."""
