using UnityEngine.Scripting;

// JsonUtility assigns fields that no code assigns; therefore the linker of IL2CPP must not strip this assembly.
[assembly: AlwaysLinkAssembly]
[assembly: Preserve]
