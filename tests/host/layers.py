# SPDX-License-Identifier: GPL-2.0-or-later
"""The layers of each C folder, lowest first. A module (NAME.c, NAME.h or both) includes and calls modules of lower
lines; those in one line may depend on each other, but not in a circle. Checked by test_layers.py."""

TABLES = {
    "package/ddx/ddxctl": """
        ddxctl
        ask change complain json record words
        fields list set stats watch
        show
        main
    """,
    "package/ddx/form": """
        fields
        declaration schema
        form
    """,
    "package/ddx/include": """
        ddx
        ddx_request ddx_stats
    """,
    "package/ddx/lib": """
        clock error expression fault hot
        layout type type_parse type_problem
        futex lock memory ring trust wire
        queue
        handle
        connection term window
        reader_role writer_readers writer_role
        reoffer
        receive
        reader reader_take writer
        direct
        info item keeper
        exchange stats stats_book stats_histogram stats_json
        remote
        request stats_takeover
    """,
    "package/ddx/program": """
        config_file descriptors exit_status replay_clock schedule version
        signals
        program
        output
    """,
    "package/ddx/store": """
        heap holder log
        checkpoint
        files listen
        state
        epoch items memfd_name retired send
        leftover
        budget descriptors notify process
        adopt claim readers
        request session
        resume worker
        main
    """,
    "package/ddxcatalog/catalog": """
        config identity item
        machines state
        directory sender
        clock outlet
        accept export mirror
        table
        catalog
    """,
    "package/ddxcatalog/ctl": """
        table_items
        catalog rosmsgs
    """,
    "package/ddxcatalog/network": """
        network
        internal
        address
        participant
        type
        records stamps value
    """,
    "package/ddxcatalog/wire": """
        bucket description name offset picture sha256
        envelope typehash
        standard
    """,
    "package/ddxlog/log": """
        config queue recover
        logger_state
        file finder mender read
        disk
        logger
    """,
    "package/ddxlog/mcap": """
        bytes
        mcap
        record
        reader
        define
        unpack write
        order
        read
    """,
    "package/ddxlog/play": """
        column replay_state
        export items line
        replay
    """,
    "package/ddxservice": """
        confine serial
    """,
    "package/ddxvideo/common": """
        fraction video_beside video_layout y4m
        picture_convert video_item y4m_layout
        as_420 y4m_parse
        y4m_read
    """,
    "package/ddxvideo/draw": """
        image layout screen_choice surface
        keys kms paint text window
        screen
    """,
    "package/ddxvideo/grab": """
        direct frame_count geometry jpeg picture_size pixels
        camera unpack
        controls convert
        grabber_state
        publish settings
        grabber
    """,
    "package/ddxvideo/grab/iidc": """
        counter iidc_controls library_log modes pace setup_wish wall
        bus format7
        setup
        iidc_camera
        main
    """,
    "package/ddxvideo/grab/v4l": """
        device reorder
        input v4l_controls
        negotiate
        device_open
        v4l_camera
        main
    """,
    "package/ddxvideo/health": """
        hw_watchdog liveness
        main
    """,
    "package/ddxvideo/load": """
        player
        main
    """,
    "package/ddxvideo/play": """
        monitor still watch
        caption
        player
        main
    """,
    "package/ddxvideo/recordings": """
        bytes check found
        find_file
        find
        show verify
        choose export
        main
    """,
    "package/ddxvideo/save": """
        decimate disk_watch frame_queue repair_plain segment_state
        recording_plan segment_index
        segment
        flusher
        recording_write
        recording
        backlog preroll
        recorder_state
        recorder_file
        recorder_frames
        commands
        recorder
        main
    """,
    "package/ddxvideo/save/pool": """
        crc32c pool_state
        index pool_lock
        pool_files
        free_space pool_names
        pool_finish
        pool_recover
        pool_prepare
        pool
    """,
    "package/ddxvideo/stereo": """
        calibration kernel luma matcher_settings
        filter kernel_rows rectifier source
        kernel_avx2 kernel_mmx kernel_scalar kernel_sse2 matcher
        ranger
        main
    """,
    "package/ddxvideo/stream": """
        bits budget chunk coefficients counters gf256 key_file network
        report rollover rtp sap sdp_read
        h264 mpeg4 reorder secure symbol
        assembly codec repair sdp secure_none
        restore
        intake
    """,
    "package/ddxvideo/stream/receive": """
        frame_420 guard link listen movie output reporter
        answer decoder display inlet list
        viewer_state
        show
        viewer
        main
    """,
    "package/ddxvideo/stream/send": """
        encoded history outlet
        deficit encode_h264 encode_mpeg4
        encoder feedback
        dispatch
        packets post
        announce ts
        sender_state
        describe
        sender
        main
    """,
    "package/ddxvideo/stream/snap": """
        montage
        main
    """,
    "package/ddxvideo/view": """
        frames_table shot
        frames_index history source
        frames live range view
        save source_file source_item source_stream status
        control
        input
        picture
        view_run
        main
    """,
}


def layers(folder: str) -> list[set[str]]:
    return [set(line.split()) for line in TABLES[folder].splitlines() if line.strip()]
