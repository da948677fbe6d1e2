# SPDX-License-Identifier: GPL-2.0-or-later
"""Defects that were once in the product: how each is put back, which test stands against it, and what that test says
then (a pattern). tools/defects.py puts them back one by one, in a copy of the tree."""
import dataclasses


@dataclasses.dataclass(frozen=True)
class Defect:
    name: str
    file: str
    now: str    # stands in the file once
    then: str   # is put there instead
    test: str   # of pytest, as it is named on its command line; or `C: name`, a test in C
    words: str


DEFECTS = [
    # Whether its page is still held was not asked then: either of the two is enough today.
    Defect("a reader's number counts with a store that did not give it", "package/ddx/lib/writer_readers.c",
           '(writer->confirmed[i] || DDX_BROKEN("numbers")) && writer->ring.reader[i].id == m->index) {\n'
           '            if (DDX_BROKEN("numbers")) {',
           "writer->ring.reader[i].id == m->index) {\n            if (true) {",
           "C: frames stay while the store is restarted", "torn|has number"),
    Defect("at full speed the loader waits for no reader", "package/ddxvideo/load/player.c",
           "player->patient = !player->speed.num && player->readers;", "player->patient = false;",
           "tests/host/test_first_frames.py", "the loader has time, and a reader"),
    Defect("the loader makes up for a stall at once", "package/ddx/program/schedule.c",
           "return due > soonest ? due : soonest;", "return soonest < 0 ? soonest : due;",
           "C: schedule", "schedule"),
    Defect("the disk is waited for where frames are read", "package/ddxvideo/save/recorder.c",
           "void recorder_end_file(struct recorder *recorder) {\n",
           "void recorder_end_file(struct recorder *recorder) {\n"
           "    extern int fdatasync(int);\n    (void)fdatasync(0);\n",
           "tests/host/test_stalled_disk.py::test_files_are_closed_by_who_writes_them", "Failed|Error"),
    Defect("frames that the disk did not take stay recorded", "package/ddxvideo/save/segment.c",
           "    ddx_stats_take_back(segment->book, LOST_WRITE, segment->frames - segment->safe_frames);\n", "",
           "tests/host/test_events.py", "counted as recorded"),
    Defect("the recorder's patience cannot be set", "package/ddxvideo/save/recorder.c",
           "recorder->keep_frames ? (unsigned)recorder->keep_frames : KEEP_FRAMES", "KEEP_FRAMES",
           "tests/host/test_faults.py::test_so_many_frames_are_kept_as_it_asks_for", "lost|assert"),
    Defect("two mounts load one driver", "overlay/etc/init.d/S15storage", "modprobe -qa ext4 crc32c_generic vfat",
           "true", "tests/host/test_storage.py", "modprobe.said"),
    Defect("a mount that is refused is not tried again", "overlay/usr/libexec/ddx/storage", "-le 5 ]", "-le 1 ]",
           "tests/host/test_storage.py", "FAIL"),
    Defect("ddxgrow does not say that it is done", "package/ddxgrow/grow", 'echo "ddxgrow: done"', ":",
           "tests/host/test_script_timing.py::test_growing_says_when_it_is_done", "Failed|Error"),
    Defect("a service's stop is lost before runsv listens", "package/ddxservice/service",
           'pgrep -x -f "runsv $1" > /dev/null || return 1', "return 1",
           "tests/host/test_script_timing.py::test_a_stop_is_heard_by_a_runsv_that_just_begins", "stopped"),
    Defect("finish breaks on an empty `begin`", "package/ddxservice/finish", "''|*[!0-9.]*) started=$now ;;",
           "none) started=$now ;;", "tests/host/test_script_timing.py::test_it_is_not_known_when_a_program_began",
           "assert"),
    Defect("a slot that cannot be read is found out by GRUB's menu", "board/common/grub.cfg",
           'if [ ! -f "($disk,$partition)/boot/vmlinuz" ]; then', "if [ 0 = 1 ]; then",
           "tests/boot/test_slots.py", "Press any key"),
    Defect("the folder that a service waits for may be a command", "package/ddxservice/settings.awk",
           'value ~ "^/[A-Za-z0-9/_-]+$"', 'value ~ "."',
           "tests/host/test_service_settings.py::test_what_root_uses_has_one_form", r"mounted=\$\(touch /x\)"),
    Defect("root follows a link in the recorder's folder", "overlay/usr/libexec/ddx/settings-copy",
           """[ "$(pwd -P) $(stat -c '%u %a' .)" = "$1 0 700" ]""", "true",
           "tests/host/test_settings_copy.py::test_nothing_of_root_s_is_written_through_a_name_of_the_recorder_s",
           "secret|made by settings-copy"),
    Defect("two recorders that start at once take one number", "package/ddxvideo/save/pool_names.c",
           "    pool_set_newest(pool, most + 1);\n", "",
           "tests/host/test_pool_names.py::test_two_recorders_of_one_item_that_start_at_once", "another file"),
    Defect("a recording whose name another file has gets no name", "package/ddxvideo/save/pool.c",
           "? 0 : -EEXIST;", "? 0 : 0;",
           "tests/host/test_pool_names.py::test_a_name_that_another_file_has", "another file"),
    Defect("the network says how much memory decode takes", "package/ddxvideo/stream/receive/decoder.c",
           "    decoder->context->get_format = choose_format;\n"
           "    decoder->context->max_pixels = limits->pixels + ROUNDED;\n",
           "    (void)choose_format;\n",
           "tests/host/test_stream_refused.py::test_a_window_has_a_bound_of_its_own", "assert .*lost|memory_mib"),
    Defect("a recording's first line is in no sum", "package/ddxvideo/recordings/check.c",
           "return header->flags & INDEX_HEAD ? check->head == header->head : fits(check);",
           "return header->flags & INDEX_HEAD ? true : fits(check);",
           "tests/host/test_recordings_bytes.py::test_each_byte", "byte 0 of"),
    Defect("each commit copies all that the store ever kept", "package/ddx/store/kept.c",
           "unsigned some = open.count > OPEN ? open.count - OPEN : 0;", "unsigned some = 0;",
           "C: kept", "kept_copied"),
    Defect("the viewer steps by two frames", "package/ddxvideo/view/input.c",
           "control_step, -1},", "control_step, -2},",
           "tests/host/test_view.py::test_item", "PAUSED video  frame 19"),
    Defect("a paused viewer shows the newest frame", "package/ddxvideo/view/control.c",
           "!view->paused && view->source->live && view->position < newest",
           "view->source->live && view->position < newest",
           "tests/host/test_view.py::test_item", "PAUSED video  frame 39"),
    Defect("pictures are drawn into the buffer that is shown", "package/ddxvideo/draw/kms.c",
           "    kms->hidden = 1 - kms->hidden;\n", "",
           "tests/boot/test_screen.py::test_each_picture_is_whole_and_newer", "torn"),
    Defect("one variant of the matcher has other bits", "package/ddxvideo/stereo/kernel_sse2.c",
           "_mm_slli_si128(high, 15)", "_mm_slli_si128(high, 14)", "C: stereo_matcher", "sse2, "),
    Defect("a calibration with NaN is taken", "package/ddxvideo/stereo/calibration.c",
           "!isfinite(*number) || ", "", "tests/host/test_calibration.py::test_what_is_no_calibration", "not a number"),
    Defect("the window of a stereo pair cannot be set", "package/ddxvideo/stereo/source.c",
           "source->window ? source->window : window_of(", "window_of(",
           "tests/host/test_pairs.py::test_a_window_that_was_set", ">= 4"),
    Defect("the viewer refuses all layouts but 4:2:0", "package/ddxvideo/view/source_item.c",
           "ddxvideo_view_any(from->item", "ddxvideo_view(from->item",
           "tests/host/test_view.py::test_item_of_each_layout", "subprocess"),
]
