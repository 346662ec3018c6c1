using UnityEngine.Scripting;

// JsonUtility fills fields that no code assigns: the linker of IL2CPP must not take this assembly apart.
[assembly: AlwaysLinkAssembly]
[assembly: Preserve]
