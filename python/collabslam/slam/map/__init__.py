"""What the map gains and loses, and how it is kept."""
