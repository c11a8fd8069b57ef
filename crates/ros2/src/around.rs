//! Counts who else is on the robot's command topics.

use crate::dds::{Controller, Member};
use crate::emergency::EmergencyStop;
use crate::ros::topic;
use dust_dds::builtin_topics::{PublicationBuiltinTopicData, SubscriptionBuiltinTopicData};
use dust_dds::infrastructure::sample_info::{ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind};
use dust_dds::subscription::subscriber::Subscriber;

pub(crate) fn look(
    builtin: &Subscriber,
    member: &Member,
    controllers: &mut [Controller],
    emergency: Option<&mut EmergencyStop>,
) {
    const ALIVE: &[InstanceStateKind] = &[InstanceStateKind::Alive];
    let publications = builtin
        .lookup_datareader::<PublicationBuiltinTopicData>("DCPSPublication")
        .ok()
        .flatten()
        .and_then(|reader| reader.read(i32::MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ALIVE).ok())
        .unwrap_or_default();
    let subscriptions = builtin
        .lookup_datareader::<SubscriptionBuiltinTopicData>("DCPSSubscription")
        .ok()
        .flatten()
        .and_then(|reader| reader.read(i32::MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ALIVE).ok())
        .unwrap_or_default();
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
        let count = publications.iter().filter_map(|sample| sample.data.as_ref()).filter(publishes).count();
        emergency.note_publishers(count);
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
        controller.publishers = publications.iter().filter_map(|sample| sample.data.as_ref()).filter(publishes).count();
        controller.readers = subscriptions.iter().filter_map(|sample| sample.data.as_ref()).filter(reads).count();
    }
}
