//! Finds the scans, phases and reconstructions that share one series and one geometry.

use std::collections::BTreeMap;

use super::image::{Image, height};
use super::labels::{Attribute, Label};
use super::stack::MIN_STEP_MM;

/// Most stacks into which a series is split.
const MAX_GROUPS: usize = 64;
/// Fewest images of each stack for a warning that stacks lie between each other: fewer are no scan of their own.
const MIN_INTERLEAVED: usize = 3;
/// Attributes that separate scans; others vary within one scan too.
const OF_SCANS: [Attribute; 7] = [
    Attribute::Acquisition,
    Attribute::TemporalPosition,
    Attribute::CardiacPhase,
    Attribute::TimeOffset,
    Attribute::StackId,
    Attribute::Voltage,
    Attribute::Kernel,
];

/// How the images of one geometry form several stacks.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Split {
    /// Indices of the images of each stack, and what distinguishes it.
    pub(super) groups: Vec<(Vec<usize>, String)>,
    /// Whether images of different stacks lie at one position; otherwise they lie between each other.
    pub(super) overlaps: bool,
}

/// Splits images of one geometry; `None` when they are one stack, or nothing tells images at one position apart.
///
/// The first attribute, else pair of attributes, that leaves no position twice in a stack separates them. Without one, it is
/// the order at each position: by time, else by the number of the image.
pub(super) fn split(images: &[Image]) -> Option<Split> {
    let slots = slots(images);
    let most = slots.iter().fold(BTreeMap::new(), |mut n, slot| {
        let count = n.entry(*slot).or_insert(0usize);
        *count = count.saturating_add(1);
        n
    });
    let most = most.values().copied().max().unwrap_or(0);
    if most < 2 {
        let groups = OF_SCANS.into_iter().find_map(|attribute| interleaved(images, &slots, attribute))?;
        return Some(Split { groups: described(images, groups, &[]), overlaps: false });
    }
    let singles = Attribute::ALL.iter().map(|a| vec![*a]);
    let pairs = Attribute::ALL
        .iter()
        .enumerate()
        .flat_map(|(at, a)| Attribute::ALL.iter().skip(at.saturating_add(1)).map(|b| vec![*a, *b]).collect::<Vec<_>>());
    let by_attributes = singles.chain(pairs).find_map(|attributes| {
        let groups = by(images, &attributes);
        let complete = groups.len() > 1 && groups.len() <= most.saturating_mul(2).min(MAX_GROUPS);
        (complete && groups.iter().all(|group| is_stack(images, &slots, group))).then_some((groups, attributes))
    });
    if let Some((groups, attributes)) = by_attributes {
        return Some(Split { groups: described(images, groups, &attributes), overlaps: true });
    }
    let times = |image: &Image| image.header.labels.time_s;
    let numbers = |image: &Image| image.header.labels.instance.map(|n| n as f64);
    let groups = by_rank(images, &slots, &times).or_else(|| by_rank(images, &slots, &numbers))?;
    Some(Split { groups: described(images, groups, &[]), overlaps: true })
}

/// Number of the position of each image, from 0 along the normal.
fn slots(images: &[Image]) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> =
        images.iter().enumerate().map(|(at, image)| (height(images, image), at)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut slots = vec![0usize; images.len()];
    let (mut slot, mut begin) = (0usize, order.first().map_or(0.0, |o| o.0));
    for (height, at) in order {
        if height - begin >= MIN_STEP_MM {
            (slot, begin) = (slot.saturating_add(1), height);
        }
        if let Some(place) = slots.get_mut(at) {
            *place = slot;
        }
    }
    slots
}

/// The images by the values of `attributes`, in the order of these.
fn by(images: &[Image], attributes: &[Attribute]) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<Vec<Option<&Label>>, Vec<usize>> = BTreeMap::new();
    for (at, image) in images.iter().enumerate() {
        let key = attributes.iter().map(|a| image.header.labels.get(*a)).collect();
        groups.entry(key).or_default().push(at);
    }
    groups.into_values().collect()
}

/// Whether no two images lie at one position, apart from copies of one image.
fn is_stack(images: &[Image], slots: &[usize], group: &[usize]) -> bool {
    let mut taken: BTreeMap<usize, &Image> = BTreeMap::new();
    group.iter().all(|at| {
        let (Some(image), Some(slot)) = (images.get(*at), slots.get(*at)) else { return false };
        let there = taken.insert(*slot, image);
        there.is_none_or(|other| {
            !image.header.labels.identifier.is_empty() && other.header.labels == image.header.labels
        })
    })
}

/// The stacks by `attribute`, when each has several images and they lie between those of others.
fn interleaved(images: &[Image], slots: &[usize], attribute: Attribute) -> Option<Vec<Vec<usize>>> {
    let groups = by(images, &[attribute]);
    let ends: Vec<(usize, usize)> = groups
        .iter()
        .filter_map(|group| {
            let of = || group.iter().filter_map(|at| slots.get(*at).copied());
            Some((of().min()?, of().max()?))
        })
        .collect();
    let inside = |group: &[usize], (low, high): (usize, usize)| {
        group.iter().filter_map(|at| slots.get(*at)).filter(|slot| (low..=high).contains(*slot)).count()
    };
    let mixed = groups
        .iter()
        .enumerate()
        .any(|(a, group)| ends.iter().enumerate().any(|(b, range)| a != b && inside(group, *range) >= MIN_INTERLEAVED));
    let whole = groups.iter().all(|group| group.len() >= MIN_INTERLEAVED);
    (groups.len() > 1 && groups.len() <= MAX_GROUPS && whole && mixed).then_some(groups)
}

/// The stacks by the order of the images at each position; `None` when positions have different numbers of images, or two of
/// one position have no order.
fn by_rank(images: &[Image], slots: &[usize], order: &dyn Fn(&Image) -> Option<f64>) -> Option<Vec<Vec<usize>>> {
    let mut at_slot: BTreeMap<usize, Vec<(f64, usize)>> = BTreeMap::new();
    for ((at, image), slot) in images.iter().enumerate().zip(slots) {
        at_slot.entry(*slot).or_default().push((order(image)?, at));
    }
    let n = at_slot.values().next()?.len();
    let mut groups = vec![Vec::new(); n];
    for mut found in at_slot.into_values() {
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let tied = found.windows(2).any(|w| matches!(w, [a, b] if a.0 == b.0));
        if found.len() != n || tied {
            return None;
        }
        groups.iter_mut().zip(found).for_each(|(group, (_, at))| group.push(at));
    }
    (n <= MAX_GROUPS).then_some(groups)
}

/// The groups with what distinguishes each: all attributes that one value in each group has and that differ, and the time.
fn described(images: &[Image], groups: Vec<Vec<usize>>, by: &[Attribute]) -> Vec<(Vec<usize>, String)> {
    let value = |group: &[usize], attribute: Attribute| {
        let mut labels = group.iter().filter_map(|at| images.get(*at)).map(|i| i.header.labels.get(attribute));
        let first = labels.next()??;
        labels.all(|label| label == Some(first)).then_some(first)
    };
    let telling: Vec<(Attribute, Vec<&Label>)> = Attribute::ALL
        .iter()
        .filter_map(|attribute| {
            let mut values: Vec<&Label> = groups.iter().filter_map(|group| value(group, *attribute)).collect();
            values.sort();
            values.dedup();
            (values.len() > 1 || by.contains(attribute)).then_some((*attribute, values))
        })
        .collect();
    let begin = |group: &[usize]| {
        let times = group.iter().map(|at| images.get(*at).and_then(|i| i.header.labels.time_s));
        times.collect::<Option<Vec<f64>>>().map(|times| times.into_iter().fold(f64::INFINITY, f64::min))
    };
    let begins: Option<Vec<f64>> = groups.iter().map(|group| begin(group)).collect();
    let first = begins.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let describe = |(index, group): (usize, &Vec<usize>)| {
        let labels = telling.iter().filter_map(|(attribute, values)| {
            let label = value(group, *attribute)?;
            let rank = values.iter().position(|v| *v == label)?.saturating_add(1);
            Some(attribute.describe(label, rank))
        });
        let mut text: Vec<String> = labels.collect();
        if let Some(begin) = begins.as_ref().and_then(|begins| begins.get(index)) {
            let after = begin - first;
            text.push(format!("{after:.1} s after the first"));
        }
        text.join(", ")
    };
    let texts: Vec<String> = groups.iter().enumerate().map(describe).collect();
    groups.into_iter().zip(texts).collect()
}
