# Packages the core as IP in Vivado: vivado -mode batch -source package_ip.tcl. Writes component.xml into this folder.
# Not run by the project's tests: there is no Vivado among its tools.
set here [file dirname [file normalize [info script]]]
create_project -in_memory -part xczu3eg-sbva484-1-i
add_files [glob $here/*.sv $here/bpn_ip.v]
set_property top bpn_ip [current_fileset]
update_compile_order -fileset sources_1
ipx::package_project -root_dir $here -vendor bpn -library user -taxonomy /UserIP -force
set core [ipx::current_core]
set_property name bpn $core
set_property display_name "Binarized policy" $core
set_property version 1.0 $core
foreach {interface clock} {s_axi aclk s_axis_pixels aclk s_axis_weights aclk} {
  ipx::associate_bus_interfaces -busif $interface -clock $clock $core
}
ipx::infer_bus_interface irq xilinx.com:signal:interrupt_rtl:1.0 $core
ipx::save_core $core
