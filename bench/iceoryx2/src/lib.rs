// SPDX-License-Identifier: GPL-2.0-or-later
//! iceoryx2 with the interface of ../peer.h: publish-subscribe for the frames, an event to sleep on.
use core::cell::UnsafeCell;
use core::ffi::{c_char, c_int, c_void, CStr};
use core::mem::MaybeUninit;
use core::time::Duration;
use std::error::Error;

use iceoryx2::port::{listener::Listener, notifier::Notifier, publisher::Publisher, subscriber::Subscriber};
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

#[repr(C)]
pub struct Setup {
    name: *const c_char,
    bytes: usize,
    readers: u32,
    mode: u32,
    own: *mut c_void,
}
const COPY: u32 = 1;

struct Out {
    publisher: Publisher<ipc::Service, [u8], ()>,
    notifier: Notifier<ipc::Service>,
    loaned: Option<SampleMutUninit<ipc::Service, [MaybeUninit<u8>], ()>>,
    bytes: usize,
    _node: Node<ipc::Service>, // last: dropped after what it owns
}

struct In {
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    listener: Listener<ipc::Service>,
    own: Option<*mut u8>,
    _node: Node<ipc::Service>,
}

enum Role {
    None,
    Writer(Out),
    Reader(In),
}

struct Global(UnsafeCell<Role>);
unsafe impl Sync for Global {} // one thread uses it
static ROLE: Global = Global(UnsafeCell::new(Role::None));

fn writer() -> &'static mut Out {
    match unsafe { &mut *ROLE.0.get() } {
        Role::Writer(out) => out,
        _ => panic!("not a writer"),
    }
}

fn status<T>(result: Result<T, Box<dyn Error>>) -> c_int {
    match result {
        Ok(_) => 0,
        Err(error) => {
            eprintln!("iceoryx2: {error}");
            1
        }
    }
}

fn open(setup: &Setup, writer: bool) -> Result<Role, Box<dyn Error>> {
    let name = unsafe { CStr::from_ptr(setup.name) }.to_str()?;
    let readers = setup.readers as usize;
    let node = NodeBuilder::new().create::<ipc::Service>()?;
    // Room for these readers and no more, one frame queued for each: the least that it works with.
    let frames = node
        .service_builder(&format!("{name}/frames").as_str().try_into()?)
        .publish_subscribe::<[u8]>()
        .payload_alignment(Alignment::new(4096).ok_or("alignment")?)
        .max_publishers(1)
        .max_subscribers(readers)
        .subscriber_max_buffer_size(1)
        .subscriber_max_borrowed_samples(1)
        .history_size(0)
        .open_or_create()?;
    let event = node
        .service_builder(&format!("{name}/event").as_str().try_into()?)
        .event()
        .max_notifiers(1)
        .max_listeners(readers)
        .open_or_create()?;
    Ok(if writer {
        Role::Writer(Out {
            publisher: frames.publisher_builder().initial_max_slice_len(setup.bytes).max_loaned_samples(1).create()?,
            notifier: event.notifier_builder().create()?,
            loaned: None,
            bytes: setup.bytes,
            _node: node,
        })
    } else {
        Role::Reader(In {
            subscriber: frames.subscriber_builder().create()?,
            listener: event.listener_builder().create()?,
            own: (setup.mode == COPY).then_some(setup.own.cast()),
            _node: node,
        })
    })
}

#[no_mangle]
pub extern "C" fn peer_open(setup: &Setup, writer: bool) -> c_int {
    set_log_level(LogLevel::Error);
    status(open(setup, writer).map(|role| unsafe { *ROLE.0.get() = role }))
}

#[no_mangle]
pub extern "C" fn peer_loan() -> *mut c_void {
    let out = writer();
    match out.publisher.loan_slice_uninit(out.bytes) {
        Ok(sample) => out.loaned.insert(sample).payload_mut().as_mut_ptr().cast(),
        Err(error) => {
            eprintln!("iceoryx2: {error}");
            core::ptr::null_mut()
        }
    }
}

fn publish() -> Result<(), Box<dyn Error>> {
    let out = writer();
    let sample = out.loaned.take().ok_or("nothing is loaned")?;
    unsafe { sample.assume_init() }.send()?;
    out.notifier.notify()?;
    Ok(())
}

#[no_mangle]
pub extern "C" fn peer_publish() -> c_int {
    status(publish())
}

#[no_mangle]
pub extern "C" fn peer_write(data: *const c_void) -> c_int {
    let frame = peer_loan();
    if frame.is_null() {
        return 1;
    }
    unsafe { core::ptr::copy_nonoverlapping(data.cast::<u8>(), frame.cast::<u8>(), writer().bytes) };
    peer_publish()
}

fn receive(deliver: extern "C" fn(*const c_void)) -> Result<(), Box<dyn Error>> {
    let Role::Reader(reader) = (unsafe { &mut *ROLE.0.get() }) else {
        return Err("not a reader".into());
    };
    let mut sample = reader.subscriber.receive()?;
    if sample.is_none() {
        reader.listener.timed_wait(|_| (), Duration::from_millis(100))?;
        sample = reader.subscriber.receive()?;
    }
    let Some(sample) = sample else {
        return Ok(());
    };
    match reader.own {
        Some(own) => {
            unsafe { core::ptr::copy_nonoverlapping(sample.payload().as_ptr(), own, sample.payload().len()) };
            deliver(own.cast());
        }
        None => deliver(sample.payload().as_ptr().cast()),
    }
    Ok(())
}

#[no_mangle]
pub extern "C" fn peer_receive(deliver: extern "C" fn(*const c_void)) -> c_int {
    status(receive(deliver))
}

#[no_mangle]
pub extern "C" fn peer_close() {
    unsafe { *ROLE.0.get() = Role::None }
}
