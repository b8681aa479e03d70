"""Rules on the commands of a job: what would harm the machine or its settings, before the first byte is sent."""
