"""Who is who on the bus: an authority of our own and a certificate for every role."""
