//! Counts who else is on the robot's command topics.

use crate::dds::{Controller, Member};
use crate::emergency::EmergencyStop;
use crate::ros::topic;
use dust_dds::builtin_topics::{PublicationBuiltinTopicData, SubscriptionBuiltinTopicData};
use dust_dds::infrastructure::sample_info::{ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind};
use dust_dds::subscription::subscriber::Subscriber;
use dust_dds::xtypes::type_support::TypeSupport;

/// Returns what a built-in topic says of those who are there.
fn alive<T: TypeSupport>(builtin: &Subscriber, name: &str) -> Vec<T> {
    const ALIVE: &[InstanceStateKind] = &[InstanceStateKind::Alive];
    let reader = builtin.lookup_datareader::<T>(name).ok().flatten();
    let samples = reader.and_then(|reader| reader.read(i32::MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ALIVE).ok());
    samples.unwrap_or_default().into_iter().filter_map(|sample| sample.data).collect()
}

/// Counts the publishers of a topic, as DDS names it, without our own.
pub(crate) fn count_publishers(builtin: &Subscriber, topic: &str, own: [u8; 16]) -> usize {
    let publications = alive::<PublicationBuiltinTopicData>(builtin, "DCPSPublication");
    publications.iter().filter(|found| found.topic_name() == topic && found.key().value != own).count()
}

/// Counts who is on the topics. Returns the number of participants that were discovered, our own two among them.
pub(crate) fn count_endpoints<'a>(
    builtin: &Subscriber,
    member: &Member,
    controllers: impl Iterator<Item = &'a mut Controller>,
    emergency: Option<&mut EmergencyStop>,
) -> usize {
    let publications = alive::<PublicationBuiltinTopicData>(builtin, "DCPSPublication");
    let subscriptions = alive::<SubscriptionBuiltinTopicData>(builtin, "DCPSSubscription");
    let there: Vec<Vec<u8>> = member
        .participant
        .get_discovered_participants()
        .unwrap_or_default()
        .into_iter()
        .map(|handle| <[u8; 16]>::from(handle)[..12].to_vec())
        .collect();
    let there: Vec<&[u8]> = there.iter().map(Vec::as_slice).collect();
    if let Some(emergency) = emergency {
        let publishes = |found: &&PublicationBuiltinTopicData| {
            found.topic_name() == emergency.topic && there.contains(&&found.key().value[..12])
        };
        let count = publications.iter().filter(publishes).count();
        emergency.set_publisher_count(count);
    }
    for controller in controllers {
        let name = topic(&controller.topic);
        let own = controller.writer.as_ref().map(|writer| writer.key());
        // A publisher whose participant left is gone.
        let publishes = |found: &&PublicationBuiltinTopicData| {
            found.topic_name() == name && Some(found.key().value) != own && there.contains(&&found.key().value[..12])
        };
        let reads = |found: &&SubscriptionBuiltinTopicData| {
            found.topic_name() == name && there.contains(&&found.key().value[..12])
        };
        controller.publishers = publications.iter().filter(publishes).count();
        controller.readers = subscriptions.iter().filter(reads).count();
    }
    there.len()
}
