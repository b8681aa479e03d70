"""Find commands of a job that would harm the machine or its settings, before anything is sent."""
