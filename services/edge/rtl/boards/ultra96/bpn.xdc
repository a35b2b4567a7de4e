# The core's only clock; in a block design the processing system's constraint takes its place.
create_clock -name aclk -period 5.000 [get_ports aclk]
