// SPDX-License-Identifier: GPL-2.0-or-later
//! A subscriber of Dust DDS: `dust_peer TOPIC COUNT` prints COUNT messages, each as a line of JSON.

use dust_dds::{
    configuration::DustDdsConfigurationBuilder,
    domain::domain_participant_factory::DomainParticipantFactory,
    infrastructure::{
        listener::NO_LISTENER,
        qos::{DataReaderQos, QosKind},
        qos_policy::{HistoryQosPolicy, HistoryQosPolicyKind, ReliabilityQosPolicy, ReliabilityQosPolicyKind},
        status::{NO_STATUS, StatusKind},
        time::{Duration, DurationKind},
        type_support::DdsType,
    },
    wait_set::{Condition, WaitSet},
};

#[derive(DdsType)]
#[dust_dds(name = "builtin_interfaces::msg::dds_::Time_")]
struct Time {
    sec: i32,
    nanosec: u32,
}

#[derive(DdsType)]
#[dust_dds(name = "std_msgs::msg::dds_::Header_")]
struct Header {
    stamp: Time,
    frame_id: String,
}

#[derive(DdsType)]
#[dust_dds(name = "ddx::msg::dds_::SENSORPart_")]
struct Part {
    x: f64,
    a: [i16; 3],
}

/// The struct of tests/host/catalog_client.c, after the fields that each message of a catalog begins with.
#[derive(DdsType)]
#[dust_dds(name = "ddx::msg::dds_::SENSOR_")]
struct Sensor {
    header: Header,
    sequence: u64,
    monotonic_ns: i64,
    number: i32,
    name: [u8; 5],
    part: [Part; 2],
    f: f32,
    last: u8,
}

fn print(message: &Sensor) {
    let Sensor { header, sequence, monotonic_ns, number, name, part, f, last } = message;
    let Header { stamp: Time { sec, nanosec }, frame_id } = header;
    let part = part.each_ref().map(|part| format!(r#"{{"x": {:?}, "a": {:?}}}"#, part.x, part.a)).join(", ");
    print!(r#"{{"sec": {sec}, "nanosec": {nanosec}, "frame_id": {frame_id:?}, "#);
    print!(r#""sequence": {sequence}, "monotonic_ns": {monotonic_ns}, "#);
    println!(r#""number": {number}, "name": {name:?}, "part": [{part}], "f": {:?}, "last": {last}}}"#, f64::from(*f));
}

fn main() {
    let words: Vec<String> = std::env::args().collect();
    let mut missing: usize = words[2].parse().unwrap();
    let factory = DomainParticipantFactory::get_instance();
    // Otherwise Cyclone DDS asks for the reader's minimal type, which Dust DDS does not give, and never sends.
    let configuration = DustDdsConfigurationBuilder::new().enable_type_information(false).build();
    *factory.get_mut_configuration() = configuration.unwrap();
    let participant = factory.create_participant(0, QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let kind = "ddx::msg::dds_::SENSOR_";
    let topic = participant.create_topic::<Sensor>(&words[1], kind, QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let qos = DataReaderQos {
        reliability: ReliabilityQosPolicy {
            kind: ReliabilityQosPolicyKind::Reliable,
            max_blocking_time: DurationKind::Finite(Duration::new(1, 0)),
        },
        history: HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepAll },
        ..Default::default()
    };
    let subscriber = participant.create_subscriber(QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let reader = subscriber
        .create_datareader::<Sensor>(&topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS)
        .unwrap();
    let arrived = reader.get_statuscondition();
    arrived.set_enabled_statuses(&[StatusKind::DataAvailable]).unwrap();
    let mut arrivals = WaitSet::new();
    arrivals.attach_condition(Condition::StatusCondition(arrived)).unwrap();
    while missing > 0 {
        arrivals.wait(Duration::new(30, 0)).unwrap();
        while let Ok(sample) = reader.take_next_sample() {
            if let Some(message) = sample.data {
                print(&message);
                missing -= 1;
            }
        }
    }
}
