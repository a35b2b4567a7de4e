# A block design for the Ultra96-V2: processing system, two DMA channels (pixels, weights), the core, its interrupt.
# After package_ip.tcl: vivado -mode batch -source block_design.tcl. Not run by the project's tests: there is no Vivado among its tools.
set here [file dirname [file normalize [info script]]]
create_project bpn_ultra96 $here/vivado -part xczu3eg-sbva484-1-i -force
set_property ip_repo_paths $here [current_project]
update_ip_catalog
create_bd_design bpn
set ps [create_bd_cell -type ip -vlnv xilinx.com:ip:zynq_ultra_ps_e ps]
set_property -dict [list CONFIG.PSU__USE__M_AXI_GP0 1 CONFIG.PSU__USE__M_AXI_GP1 0 CONFIG.PSU__USE__M_AXI_GP2 0 \
  CONFIG.PSU__USE__S_AXI_GP2 1 CONFIG.PSU__USE__IRQ0 1 CONFIG.PSU__FPGA_PL0_ENABLE 1 \
  CONFIG.PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ 200] $ps
set core [create_bd_cell -type ip -vlnv bpn:user:bpn:1.0 bpn]
foreach stream {pixels weights} {
  set dma [create_bd_cell -type ip -vlnv xilinx.com:ip:axi_dma dma_$stream]
  set_property -dict [list CONFIG.c_include_sg 0 CONFIG.c_include_s2mm 0 CONFIG.c_m_axis_mm2s_tdata_width 32] $dma
  connect_bd_intf_net [get_bd_intf_pins dma_$stream/M_AXIS_MM2S] [get_bd_intf_pins bpn/s_axis_$stream]
  apply_bd_automation -rule xilinx.com:bd_rule:axi4 -config "Master /ps/M_AXI_HPM0_FPD" [get_bd_intf_pins dma_$stream/S_AXI_LITE]
  apply_bd_automation -rule xilinx.com:bd_rule:axi4 -config "Slave /ps/S_AXI_HP0_FPD" [get_bd_intf_pins dma_$stream/M_AXI_MM2S]
}
apply_bd_automation -rule xilinx.com:bd_rule:axi4 -config "Master /ps/M_AXI_HPM0_FPD" [get_bd_intf_pins bpn/s_axi]
connect_bd_net [get_bd_pins bpn/irq] [get_bd_pins ps/pl_ps_irq0]
set_property offset 0x00A0000000 [get_bd_addr_segs -of_objects [get_bd_intf_pins bpn/s_axi]]
validate_bd_design
save_bd_design
make_wrapper -files [get_files bpn.bd] -top -import
launch_runs impl_1 -to_step write_bitstream -jobs 2
wait_on_run impl_1
