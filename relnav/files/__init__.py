"""All input and output: models, logs, tables."""
