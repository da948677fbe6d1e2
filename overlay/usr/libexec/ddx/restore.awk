# SPDX-License-Identifier: GPL-2.0-or-later
# Writes the copy of the settings, made by settings-copy, as files into `folder`. A service gets only the lines that
# `service` would accept. If `service` would refuse to start it because of a line, the service is switched off instead,
# since the line's meaning is unknown. Other files (a logger's) get all lines that are text. Prints the lines left out.

function leave_out() {
	missing = missing (missing == "" ? "" : ", ") name " line " number
}

function is_service(line, file) {
	file = "/etc/default/" program
	if ((getline line < file) < 0) return 0
	close(file)
	return 1
}

function finish() {
	if (off) print "enabled=no" > file
	off = 0
	if (file != "") close(file)
}

/^--- [A-Za-z0-9_][A-Za-z0-9._-]*\.conf ---$/ {
	finish()
	name = $2
	number = 0
	file = folder "/" name
	printf "" > file
	program = name
	sub(/\..*/, "", program)
	sub(/^(catalog|decode|store)$/, "ddx&", program) # the names before release 0.3.0
	service = is_service()
	next
}
file == "" { next }
{ number++ }
!service {
	text = $0
	gsub(/[\t\r]/, " ", text)
	if (text ~ /[[:cntrl:]]/) leave_out()
	else print > file
	next
}
is_setting() {
	if (key == "user")
		leave_out()
	else if (wanted() != "") {
		leave_out()
		off = 1
	} else
		print > file
	next
}
ignored != "" || /[[:cntrl:]]/ { leave_out(); next }
{ print > file }

END {
	finish()
	if (missing != "") print missing
}
