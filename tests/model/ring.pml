/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The slot protocol of package/ddx/lib/ring.h, for Spin: README.md lists what is modelled and what is not. Steps have
 * the names of ring.h (W1 .. W7, R1 .. R5) and the function that has them. A statement outside atomic and d_step is one
 * step, and others may act before and after it; an atomic has one access to shared memory at most, or stores that
 * no other process can see yet. A #define in capitals switches a fault on, for a run that must fail.
 */
#ifndef FRAMES
#define FRAMES 3 /* number of the last write */
#endif
#ifndef TAKES
#define TAKES 2 /* frames that each reader takes; afterwards it stays without a pin */
#endif
#ifndef CRASHES
#define CRASHES 1 /* of writers, each followed by another one */
#endif
#ifndef DEATHS
#define DEATHS 1 /* of readers, while they hold a frame */
#endif
#define READERS 2 /* at a time */
#ifndef FIRST
#define FIRST 0 /* readers from the beginning; the others come at any time, or never */
#endif
#define PAGES (READERS + DEATHS) /* pin pages: also of readers that come when another has died */
#define SLOTS (READERS + 2)
#ifdef ONE_SLOT_TOO_FEW
#define SPARE 1
#else
#define SPARE 2 /* slots beyond one a reader: the newest frame, and the one being written */
#endif
#define EPOCHS (CRASHES + 1)

/* layout.h, in fewer bits */
#define EMPTY 1
#define WRITING 3
#define WHOLE(number) ((number) * 2)
#define ODD(generation) ((generation) & 1)
#define LATEST(number, slot) ((number) * 8 + (slot))
#define LATEST_SLOT(latest) ((latest) & 7)
#define LATEST_NUMBER(latest) ((latest) / 8)
#define NO_SLOT 7
#define PIN(epoch, slot) (((epoch) + 1) * 8 + (slot)) /* 0: none */

/* ---- shared memory ---- */
typedef Slot {
    byte generation = EMPTY;
    byte frame /* with its number and time: FRAME() */
};
typedef Epoch {
    byte latest = NO_SLOT;
    Slot slot[SLOTS]
};
Epoch epoch[EPOCHS];
byte pin[PAGES];
byte notice; /* version */
#define FRAME(epoch, number) ((epoch) * 16 + (number)) /* unique for each write */
#define NUMBER(frame) ((frame) & 15)

/*
 * ---- store buffers: stores that no other process sees yet ----
 * One for each kind of word, flushed in any order: weaker than x86, where stores stay in order. A release store lands
 * after the earlier ones. A sequentially consistent store waits until it and all earlier ones have landed.
 */
#define NONE 255
byte frame_slot = NONE, frame_stored;
byte generation_slot = NONE, generation_stored;
byte latest_stored = NONE;
byte pin_stored[PAGES] = NONE;
#define ALL_LANDED (frame_slot == NONE && generation_slot == NONE && latest_stored == NONE)
#ifdef NO_RELEASE_OF_FRAME
#define GENERATION_MAY_LAND true
#define LATEST_MAY_LAND true
#else
#define GENERATION_MAY_LAND (frame_slot == NONE)
#define LATEST_MAY_LAND (frame_slot == NONE && generation_slot == NONE)
#endif

/* ---- the store as others see it: one process without races, reached by messages ---- */
byte current;  /* epoch announced to readers */
byte attached = (1 << FIRST) - 1; /* a bit for each reader */
byte kept = FIRST;                /* how many */
byte slots = SPARE + FIRST;
byte asleep[PAGES]; /* 1 + the epoch whose `latest` it sleeps on; 0: awake */
byte crashes, deaths;

/* ---- only for the properties ---- */
byte published[FRAMES + 1]; /* the frame of each number that was published, 0 if none */
byte newest;                /* the highest number among them */
bool stuck;                 /* the writer found all slots pinned, and no pin has moved since */

inline now_published(number) {
    assert(number == newest + 1);
    published[number] = FRAME(current, number);
    newest = number
}

inline move_pin(i, value) {
    pin[i] = value;
    stuck = false
}

active proctype memory() {
end:
    do
    :: d_step { frame_slot != NONE ->
        epoch[current].slot[frame_slot].frame = frame_stored;
        frame_slot = NONE;
        frame_stored = 0
    }
    :: d_step { generation_slot != NONE && GENERATION_MAY_LAND ->
        epoch[current].slot[generation_slot].generation = generation_stored;
        generation_slot = NONE;
        generation_stored = 0
    }
    :: d_step { latest_stored != NONE && LATEST_MAY_LAND ->
        epoch[current].latest = latest_stored;
        now_published(LATEST_NUMBER(latest_stored));
        latest_stored = NONE
    }
    :: d_step { pin_stored[0] != NONE -> move_pin(0, pin_stored[0]); pin_stored[0] = NONE }
    :: d_step { pin_stored[1] != NONE -> move_pin(1, pin_stored[1]); pin_stored[1] = NONE }
#if DEATHS
    :: d_step { pin_stored[2] != NONE -> move_pin(2, pin_stored[2]); pin_stored[2] = NONE }
#endif
    od
}

inline wake(e) {
    asleep[0] = (asleep[0] == 1 + e -> 0 : asleep[0]);
    asleep[1] = (asleep[1] == 1 + e -> 0 : asleep[1]);
#if DEATHS
    asleep[2] = (asleep[2] == 1 + e -> 0 : asleep[2])
#endif
}

/* ---- the writer; after its death the same process is the next one ---- */
#ifdef NEWEST_IS_REUSED
#define FREE(s) (s < slot_count && !(tried & (1 << s)))
#else
#define FREE(s) (s < slot_count && s != own_newest && !(tried & (1 << s)))
#endif
#define UNUSED(s) (FREE(s) && epoch[current].slot[s].generation == EMPTY)
/* All slots that were never written are equal: take the first. */
#define MAY_CHOOSE(s, below) (FREE(s) && !(UNUSED(s) && (below)))

/* A crash before a store: only the completed stores matter. */
#define OR_CRASH :: crashes < CRASHES -> goto crashed

active proctype writer() {
    byte known = (1 << FIRST) - 1, slot_count = SPARE + FIRST, notice_seen, number; /* struct ddx_ring_writer */
    byte own_newest = NO_SLOT;
    byte slot, before, tried, i;

next: /* ddx_ring_choose() */
    atomic {
        slot = 0;
        if
        :: number == FRAMES -> goto done
        :: else
        fi
    }
W1: /* oldest(); here any slot, more than the code does */
    atomic {
        if
        :: MAY_CHOOSE(0, false) -> slot = 0
        :: MAY_CHOOSE(1, UNUSED(0)) -> slot = 1
        :: MAY_CHOOSE(2, UNUSED(0) || UNUSED(1)) -> slot = 2
        :: MAY_CHOOSE(3, UNUSED(0) || UNUSED(1) || UNUSED(2)) -> slot = 3
        :: !FREE(0) && !FREE(1) && !FREE(2) && !FREE(3) ->
            assert(tried); /* else -ENOBUFS */
            assert(!stuck);
            stuck = true;
            tried = 0;
            goto W1
        fi
    }
#ifndef NO_ODD_MARK
    if /* W2, ddx_ring_choose(): atomic_store(generation, DDX_WRITING) */
#ifdef NO_FENCE_OF_WRITER
    :: d_step { generation_slot == NONE ->
        before = epoch[current].slot[slot].generation;
        generation_slot = slot;
        generation_stored = WRITING
    }
#else
    :: d_step { ALL_LANDED ->
        before = epoch[current].slot[slot].generation;
        epoch[current].slot[slot].generation = WRITING
    }
#endif
    OR_CRASH
    fi;
#endif
#ifndef NO_LOOK_AT_NOTICE
    if /* W3, ddx_ring_choose(): notice->version */
    :: atomic { notice != notice_seen ->
        /* ddx_writer_on_slot(), ddx_writer_on_reader(), ddx_writer_on_reader_gone() */
        known = attached;
        slot_count = slots;
        notice_seen = notice;
        tried = 0;
        stuck = false;
        goto undo
    }
    :: else
    fi;
#endif
#ifndef NO_LOOK_AT_PINS
W4: /* pinned(), a step for each pin */
    do
    :: atomic { i == PAGES -> i = 0; break }
    :: atomic { i < PAGES ->
        if
        :: (known & (1 << i)) && pin[i] == PIN(current, slot) -> i = 0; tried = tried | (1 << slot); goto undo
        :: else
        fi;
        i++;
        do
        :: i < PAGES && !(known & (1 << i)) -> i++
        :: else -> break
        od
    }
    od;
#endif
    if /* W5, the caller's frame; ddx_ring_publish(): number and time */
    :: atomic { frame_slot == NONE ->
        tried = 0;
        before = 0;
        stuck = false;
        number++;
        frame_slot = slot;
        frame_stored = FRAME(current, number)
    }
    OR_CRASH
    fi;
    if /* W6, ddx_ring_publish(): generation := even, release */
    :: atomic { generation_slot == NONE -> generation_slot = slot; generation_stored = WHOLE(number) }
    OR_CRASH
    fi;
    own_newest = slot;
    if /* W7, ddx_ring_publish(): latest := slot, release */
    :: atomic { latest_stored == NONE -> latest_stored = LATEST(number, slot) }
    OR_CRASH
    fi;
    if /* W7, ddx_futex_wake(); the kernel has a barrier before it searches sleepers */
    :: d_step { ALL_LANDED ->
#ifndef NO_WAKE
        wake(current);
#endif
        skip
    }
    OR_CRASH
    fi;
    goto next;

undo: /* ddx_ring_choose(): generation := before, release */
#ifndef NO_ODD_MARK
    if
    :: atomic { generation_slot == NONE -> generation_slot = slot; generation_stored = before; before = 0 }
    OR_CRASH
    fi;
#endif
    goto W1;

crashed:
    atomic {
        crashes++;
        tried = 0;
        before = 0;
        i = 0;
        stuck = false;
        /* The store notices the death after the dead writer's stores have landed. Its writer_claim(),
         * epoch_carry_over() and go_live(): the last published frame is the first of a new epoch, which readers get. */
        ALL_LANDED;
        own_newest = NO_SLOT;
        slot = LATEST_SLOT(epoch[current].latest); /* ddx_ring_peek() */
        number = LATEST_NUMBER(epoch[current].latest);
#ifdef LAST_WHOLE_FRAME
        do /* newer frames that were not published */
        :: i == SLOTS -> i = 0; break
        :: else ->
            if
            :: !ODD(epoch[current].slot[i].generation) && epoch[current].slot[i].generation > WHOLE(number) ->
                number = epoch[current].slot[i].generation / 2;
                slot = i
            :: else
            fi;
            i++
        od;
#endif
#ifdef NUMBERS_BEGIN_ANEW
        number = 0;
#else
        assert(number == newest); /* no number is used twice or left out */
#endif
        if
#ifndef NO_CARRY_OVER
        :: slot != NO_SLOT && !ODD(epoch[current].slot[slot].generation) ->
            epoch[current + 1].slot[0].frame = epoch[current].slot[slot].frame;
            epoch[current + 1].slot[0].generation = epoch[current].slot[slot].generation;
            epoch[current + 1].latest = LATEST(number, 0);
            own_newest = 0
#endif
        :: else
        fi;
        slot = 0;
        current++;
        assert(newest == 0 || LATEST_NUMBER(epoch[current].latest) == newest); /* the last frame stays readable */
        known = attached;
        slots = SPARE + kept;
        slot_count = slots;
        notice_seen = notice
    }
    goto next;
done:
    skip
}

/* ---- readers ---- */
#ifdef PIN_OF_FIRST_EPOCH
#define PIN_EPOCH first
#else
#define PIN_EPOCH own
#endif
#define AT epoch[own].slot[slot]
#ifdef ANY_WHOLE_FRAME
#define OVERTAKEN ODD(AT.generation)
#else
#define OVERTAKEN (expected != AT.generation)
#endif
#ifdef UNPUBLISHED_IN_ORDER
#define IS_NEW(s) (epoch[own].slot[s].generation > WHOLE(seen) && !ODD(epoch[own].slot[s].generation))
#else
#define IS_NEW(s) (epoch[own].slot[s].generation > WHOLE(seen) && !ODD(epoch[own].slot[s].generation) && \
                   epoch[own].slot[s].generation <= WHOLE(LATEST_NUMBER(epoch[own].latest)))
#endif

/* Both looks at a frame show the same frame, the one published under its number. */
inline look() {
    assert(frame == AT.frame && frame == published[NUMBER(frame)])
}

inline unpin() { /* ddx_ring_unpin(), release; all looks at the frame came before */
    pin_stored[me] == NONE;
    pin_stored[me] = 0;
    slot = 0;
    frame = 0
}

active [PAGES] proctype reader() {
    byte me = _pid - 2; /* after memory and writer */
    byte own, seen, taken, slot, expected, frame;
#ifdef PIN_OF_FIRST_EPOCH
    byte first;
#endif

    if
    :: me < FIRST -> goto take
    :: else
    fi;
end_not_in:
    atomic { /* store/readers.c reader_attach(): the newest frame, then messages for the writer, then the answer */
        kept < READERS && (me < READERS || deaths > 0) ->
        own = current;
#ifdef PIN_OF_FIRST_EPOCH
        first = current;
#endif
        seen = LATEST_NUMBER(epoch[current].latest);
        kept++;
        slots = (slots < SPARE + kept -> SPARE + kept : slots);
        attached = attached | (1 << me);
#ifndef NOTICE_AFTER_READER
        notice++
#endif
    }
#ifdef NOTICE_AFTER_READER
    if
    :: notice++
    :: skip /* not yet */
    fi;
#endif
#ifdef SLEEP
take:
#else
take:
end_take:
#endif
    /* ddx_reader_take() */
    if
    :: atomic { own != current -> own = current } /* ddx_reader_follow(), sooner or later */
        goto take
    :: atomic { LATEST_NUMBER(epoch[own].latest) > seen -> /* R1 DDX_NEXT; DDX_CURRENT if there is a new one */
        slot = LATEST_SLOT(epoch[own].latest);
        expected = WHOLE(LATEST_NUMBER(epoch[own].latest)) /* ddx_ring_published() */
    }
    :: atomic { /* R1 DDX_IN_ORDER, ddx_ring_next(); here any new frame, more than the code does */
        if
        :: IS_NEW(0) -> slot = 0
        :: IS_NEW(1) -> slot = 1
        :: IS_NEW(2) -> slot = 2
        :: IS_NEW(3) -> slot = 3
        fi;
        expected = AT.generation
    }
#ifdef SLEEP
    :: atomic { /* ddx_futex_wait(): asleep unless `latest` has changed; without SLEEP, waiting is looking again */
        LATEST_NUMBER(epoch[own].latest) <= seen -> asleep[me] = 1 + own
    }
end_asleep:
        if
        :: !asleep[me]
#ifndef NO_WORD_OF_NEW_EPOCH
        :: own != current -> asleep[me] = 0 /* ddx_reader_wake(), until the reader has noticed */
#endif
        fi;
        goto take
#endif
    fi;

    /* R2, ddx_ring_pin(): atomic_store(pin, ...) */
#ifdef NO_FENCE_OF_READER
    atomic { pin_stored[me] == NONE -> pin_stored[me] = PIN(PIN_EPOCH, slot) };
#else
    d_step { pin_stored[me] == NONE -> move_pin(me, PIN(PIN_EPOCH, slot)) };
#endif
    if
#ifndef NO_RECHECK
    :: atomic { /* R3, ddx_ring_pin(): not the expected generation */
        OVERTAKEN ->
        expected = 0;
        unpin();
        goto take
    }
    :: atomic { !OVERTAKEN -> expected = 0 }
#else
    :: expected = 0
#endif
    :: atomic { deaths < DEATHS -> /* at any time from its pin on: only the remaining pin matters */
        deaths++;
        expected = 0;
        goto dead
    }
    fi;
    frame = AT.frame; /* R4, and ddx_ring_pin(): sequence_of() */
    atomic {
        look();
        assert(NUMBER(frame) > seen); /* numbers never go back, no frame comes twice */
        do /* count_missed() counts all in between, each of which was published */
        :: seen + 1 == NUMBER(frame) -> break
        :: else -> seen++; assert(published[seen])
        od;
        seen++
    }
#ifdef FOLLOW_WHILE_HELD
    if
    :: own != current -> own = current
    :: skip
    fi;
#endif
#ifdef NO_RELEASE_OF_PIN
    atomic { pin_stored[me] == NONE -> pin_stored[me] = 0 };
    look();
    slot = 0; frame = 0;
#else
    atomic { look(); unpin() }; /* R4, R5 */
#endif
    atomic {
        taken++;
        if
        :: taken < TAKES -> goto take
        :: else -> own = 0; seen = 0; goto done
        fi
    }

dead:
    atomic { /* store/readers.c reader_left() */
        pin_stored[me] == NONE ->
        attached = attached & ~(1 << me);
        kept--;
        own = 0; seen = 0; slot = 0; frame = 0; taken = 0
    }
done:
    skip
}

/* When no process can step, no reader sleeps over a frame that it has not seen. */
active proctype onlooker() {
end:
    timeout ->
    assert(!asleep[0] || reader[2]:seen == newest);
    assert(!asleep[1] || reader[3]:seen == newest);
#if DEATHS
    assert(!asleep[2] || reader[4]:seen == newest)
#endif
}
