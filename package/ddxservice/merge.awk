# SPDX-License-Identifier: GPL-2.0-or-later
# Merges the settings files of `instance` of `program` for `service`; a later file overrides, key by key. Prints a line
# each: `enabled` (`wrong`: a value was refused), `needs`, `once`, `oom_score_adj`, `mounted`, and the rest ready for a
# shell's command line, every value in single quotes.

function quoted(text) {
	gsub(/\047/, "\047\\\047\047", text)
	return "\047" text "\047"
}

function tell(text) {
	print FILENAME ": line " FNR text > "/dev/stderr"
}

!is_setting() {
	if (ignored != "") tell(" " ignored)
	next
}
key == "user" && FILENAME !~ /^\/etc\/default\// {
	tell(": user= is allowed only in the image's file, ignored")
	next
}
(needed = wanted()) != "" {
	tell(": " key "=" value ": " needed " is needed")
	wrong = 1
	next
}
{
	if (!(key in values)) order[++count] = key
	values[key] = value
}

END {
	print wrong ? "wrong" : (values["enabled"] == "no") ? "no" : "yes"
	print values["needs"]
	print (values["once"] == "yes") ? "yes" : "no"
	print values["oom_score_adj"]
	print values["mounted"]
	line = (values["realtime"] == "") ? "" : "chrt -f " quoted(values["realtime"]) " "
	line = line "chpst -u " quoted((values["user"] == "" ? "nobody" : values["user"]) ":ddx")
	if (values["priority"] != "") line = line " -n " quoted(values["priority"])
	# Of what the program allocates: the store's memory, which all programs map, does not count.
	if (values["memory_limit"] != "") line = line " -d " int(values["memory_limit"]) * 1024 * 1024
	# no further privileges, not even from a program with the set-user-ID bit
	line = line " setpriv --nnp " quoted("/usr/bin/" program)
	if (values["argument"] != "") line = line " " quoted(values["argument"])
	if (instance != program) line = line " -instance " quoted(instance)
	for (i = 1; i <= count; i++) {
		key = order[i]
		if (key ~ /^(enabled|needs|once|oom_score_adj|mounted|memory_limit|user|priority|realtime|argument)$/) continue
		line = line " -" key (values[key] == "" ? "" : " " quoted(values[key]))
	}
	print line
}
