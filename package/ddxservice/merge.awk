# SPDX-License-Identifier: GPL-2.0-or-later
# Merges the settings files of `instance` of `program` for `service`; a later file overrides, key by key. The first one,
# `defaults`, is the image's. Prints a line each: `enabled` (`wrong`: a value was refused), `needs`, `once`, `stop_seconds`, and
# then the lines of the file for launch.c.

# Of a setting that the service itself uses; without a value, that is none.
function put(name, text) {
	if (text != "") print name "=" text
}

function tell(text) {
	print FILENAME ": line " FNR text > "/dev/stderr"
}

!is_setting() {
	if (ignored != "") tell(" " ignored)
	next
}
key == "user" && FILENAME != defaults {
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
	print (values["stop_seconds"] == "") ? 5 : values["stop_seconds"]
	put("user", values["user"] == "" ? "nobody" : values["user"])
	put("group", "ddx")
	put("nice", values["priority"])
	put("realtime", values["realtime"])
	put("oom_score_adj", values["oom_score_adj"])
	# Of what the program allocates: the store's memory, which all programs map, does not count.
	if (values["memory_limit"] != "") printf "memory_limit=%.0f\n", int(values["memory_limit"]) * 1024 * 1024
	put("mounted", values["mounted"])
	put("argument", "/usr/bin/" program)
	put("argument", values["argument"])
	if (instance != program) {
		put("argument", "-instance")
		put("argument", instance)
	}
	for (i = 1; i <= count; i++) {
		key = order[i]
		if (key ~ /^(enabled|needs|once|oom_score_adj|mounted|memory_limit|stop_seconds|user|priority|realtime|argument)$/) continue
		put("argument", "-" key)
		put("argument", values[key])
	}
	print "end"
}
