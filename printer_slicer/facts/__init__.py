"""Facts about sliced and planned parts, for JSON, and sentences that tell them to people."""
