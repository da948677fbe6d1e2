# SPDX-License-Identifier: GPL-2.0-or-later
# Sort the aliases of devices, each once: what the first frame needs comes first (video, USB, FireWire), then watchdogs
# and the network. Displays (PCI class 03, and virtio's) are left out; with -v displays=1 only they are printed.
seen[$0]++ || /^pci:.*bc03sc|^virtio:d00000010v/ != (displays != "") { next }
/^pci:.*bc04sc[08]0|^usb:.*ic0[Ee]/ { video = video $0 "\n"; next }
/^pci:.*bc0Csc03|^usb:/ { usb = usb $0 "\n"; next }
/^pci:.*bc0Csc00|^ieee1394:/ { firewire = firewire $0 "\n"; next }
/^pci:.*bc08sc80|^pci:.*bc06sc01|[Ww][Dd][Tt]/ { watchdog = watchdog $0 "\n"; next }
/^pci:.*bc02|^virtio:d00000001v/ { network = network $0 "\n"; next }
{ other = other $0 "\n" }
END { printf "%s", video usb firewire watchdog network other }
