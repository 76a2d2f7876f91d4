"""The worn pose's parts on recordings of real people and real inertial units."""
